-- The table counts only while it is made from the layers that are there.
SELECT t.soil_report
FROM cell_tables t, LATERAL (
    SELECT max(id) FILTER (WHERE name = 'elevation') AS elevation, max(id) FILTER (WHERE name = 'soil') AS soil
    FROM layers
    WHERE region_id = t.region_id AND state = 'current'
) present
WHERE t.region_id = %s AND t.elevation_layer_id = present.elevation AND t.soil_layer_id IS NOT DISTINCT FROM present.soil
