SELECT id, name, srid, rows, columns, cell_size_m, west_m, north_m, revision FROM regions WHERE name = %s
