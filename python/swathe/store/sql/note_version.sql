INSERT INTO swathe.schema_versions (version, name) VALUES (%s, %s)
