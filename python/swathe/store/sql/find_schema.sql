SELECT to_regclass('swathe.schema_versions') IS NOT NULL
