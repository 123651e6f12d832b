COPY tiles (layer_id, tile_row, tile_column, rast, rast_2, rast_4, rast_8, rast_16, rast_32, rast_64) FROM STDIN
