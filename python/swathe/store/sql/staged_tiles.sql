SELECT tile_row, tile_column FROM tiles WHERE layer_id = %s
