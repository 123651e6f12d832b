SELECT max(version) FROM swathe.schema_versions
