SELECT ST_AsBinary(p.geom, 'NDR'), p.value, p.soil_class, p.cat, p.attributes
FROM regions r
JOIN layers l ON l.region_id = r.id AND l.name = 'soil' AND l.kind = 'polygons' AND l.state = 'current'
JOIN soil_polygons p ON p.layer_id = l.id
WHERE r.name = %s
ORDER BY p.ordinal
