DELETE FROM regions WHERE name = %s
