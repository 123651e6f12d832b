INSERT INTO cell_tables (region_id, elevation_layer_id, soil_layer_id, soil_report)
VALUES (%(region)s, %(elevation)s, %(soil)s, %(report)s)
ON CONFLICT (region_id) DO UPDATE
SET elevation_layer_id = excluded.elevation_layer_id, soil_layer_id = excluded.soil_layer_id,
    soil_report = excluded.soil_report
