SELECT ST_AsBinary(p.geom, 'NDR'), p.name, p.attributes
FROM regions r
JOIN layers l ON l.region_id = r.id AND l.name = 'zones' AND l.kind = 'polygons' AND l.state = 'current'
JOIN zone_polygons p ON p.layer_id = l.id AND p.geom && ST_MakeEnvelope(%s, %s, %s, %s, r.srid)
WHERE r.name = %s
ORDER BY p.ordinal
