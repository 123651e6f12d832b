WITH added AS (
    INSERT INTO regions (name, crs_wkt, srid, rows, columns, cell_size_m, west_m, north_m, file_origin_x, file_origin_y,
                         file_unit_m)
    VALUES (%(name)s, %(crs_wkt)s, %(srid)s, %(rows)s, %(columns)s, %(cell_size_m)s, %(west_m)s, %(north_m)s,
            %(file_origin_x)s, %(file_origin_y)s, %(file_unit_m)s)
    ON CONFLICT (name) DO NOTHING
    RETURNING id
)
SELECT id FROM added
