COPY (
    SELECT "row", "column", coalesce(height, 'NaN'), coalesce(elevation_m, 'NaN'), coalesce(steepest_grade, 'NaN'),
           soil_category
    FROM cells
    WHERE region_id = %s
    ORDER BY "row", "column"
) TO STDOUT (FORMAT binary)
