-- Tables I and II and equation 1 of the paper, as swathe.rank has them in the profile `literal`.
WITH known AS (
    SELECT "row", "column", nullif(height, 'NaN') AS height, nullif(elevation_m, 'NaN') AS elevation_m,
           nullif(steepest_grade, 'NaN') AS steepest_grade, soil_category
    FROM new_cells
), near AS (
    -- Neighbours in a column, a row and both diagonals; where the map ends or is unknown they do not count.
    SELECT *,
           lag(height) OVER across AS west, lead(height) OVER across AS east,
           lag(height) OVER along AS north, lead(height) OVER along AS south,
           lag(height) OVER falling AS north_west, lead(height) OVER falling AS south_east,
           lag(height) OVER rising AS north_east, lead(height) OVER rising AS south_west
    FROM known
    WINDOW across AS (PARTITION BY "row" ORDER BY "column"),
           along AS (PARTITION BY "column" ORDER BY "row"),
           falling AS (PARTITION BY "row" - "column" ORDER BY "row"),
           rising AS (PARTITION BY "row" + "column" ORDER BY "row")
), steps AS (
    -- The worst of eight differences of grey levels, a diagonal counted per unit of distance.
    SELECT *,
           coalesce(greatest(
               abs(west - height)::double precision, abs(east - height)::double precision,
               abs(north - height)::double precision, abs(south - height)::double precision,
               abs(north_west - height)::double precision / sqrt(2::double precision),
               abs(north_east - height)::double precision / sqrt(2::double precision),
               abs(south_west - height)::double precision / sqrt(2::double precision),
               abs(south_east - height)::double precision / sqrt(2::double precision)
           ), 0) AS worst
    FROM near
), rounded AS (
    -- Half away from zero, which round() of a double precision is not.
    SELECT *, floor(worst) + CASE WHEN worst - floor(worst) >= 0.5 THEN 1 ELSE 0 END AS difference
    FROM steps
), good AS (
    SELECT *,
           CASE WHEN height IS NULL THEN NULL
                WHEN difference = 0 THEN 5
                WHEN difference <= 66 THEN 4
                WHEN difference <= 129 THEN 3
                WHEN difference <= 192 THEN 2
                ELSE 1
           END AS gradient_goodness,
           CASE soil_category WHEN 1 THEN 5 WHEN 2 THEN 4 WHEN 3 THEN 3 WHEN 4 THEN 2 WHEN 0 THEN 3 ELSE 1 END
               AS soil_goodness
    FROM rounded
)
INSERT INTO cells (region_id, "row", "column", height, elevation_m, steepest_grade, soil_category, gradient_goodness,
                   soil_goodness, rank)
SELECT %(region)s, "row", "column", height, elevation_m, steepest_grade, soil_category, gradient_goodness, soil_goodness,
       coalesce(gradient_goodness + soil_goodness, 0)
FROM good
