SELECT r.id, r.name, r.crs_wkt, r.srid, r.rows, r.columns, r.cell_size_m, r.west_m, r.north_m, r.file_origin_x,
       r.file_origin_y, r.file_unit_m, r.revision,
       l.name, l.kind, l.dtype, l.inputs, l.crs, l.licence, l.author, l.time, l.options, l.details
FROM regions r
LEFT JOIN layers l ON l.region_id = r.id AND l.state = 'current'
WHERE %(name)s::text IS NULL OR r.name = %(name)s
ORDER BY r.name COLLATE "C", l.name COLLATE "C"
