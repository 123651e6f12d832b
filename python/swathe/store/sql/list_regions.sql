SELECT name FROM regions ORDER BY name COLLATE "C"
