SELECT id, ST_AsBinary(geom, 'NDR'), vehicle, summary, author, time FROM routes WHERE region_id = %s
ORDER BY time COLLATE "C", id COLLATE "C"
