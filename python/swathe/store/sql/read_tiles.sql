SELECT l.dtype, r.rows, r.columns, t.tile_row, t.tile_column, ST_AsBinary(t.{column})
FROM regions r
JOIN layers l ON l.region_id = r.id AND l.name = %(layer)s AND l.kind = 'raster' AND l.state = 'current'
LEFT JOIN tiles t ON t.layer_id = l.id
    AND t.tile_row BETWEEN %(first_row)s AND %(last_row)s
    AND t.tile_column BETWEEN %(first_column)s AND %(last_column)s
WHERE r.name = %(region)s
