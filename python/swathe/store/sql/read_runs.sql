SELECT id, log, summary, author, time FROM runs WHERE region_id = %s
ORDER BY time COLLATE "C", id COLLATE "C"
