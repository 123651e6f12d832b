COPY new_cells ("row", "column", height, elevation_m, steepest_grade, soil_category) FROM STDIN (FORMAT binary)
