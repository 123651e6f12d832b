CREATE TEMPORARY TABLE new_cells (
    "row" integer, "column" integer, height real, elevation_m real, steepest_grade real, soil_category smallint
) ON COMMIT DROP
