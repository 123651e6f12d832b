DELETE FROM tiles WHERE layer_id = %s AND tile_row = %s AND tile_column = %s
