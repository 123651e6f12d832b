CREATE SCHEMA IF NOT EXISTS swathe;
CREATE TABLE swathe.schema_versions (
    version integer PRIMARY KEY,
    name    text NOT NULL,
    made_at timestamptz NOT NULL DEFAULT now()
)
