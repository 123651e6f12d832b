-- Rasters in tiles of 256 x 256 cells, each with its overviews.

CREATE TABLE tiles (
    layer_id    bigint NOT NULL REFERENCES layers ON DELETE CASCADE,
    tile_row    integer NOT NULL,
    tile_column integer NOT NULL,
    rast        raster NOT NULL,
    rast_2      raster NOT NULL,
    rast_4      raster NOT NULL,
    rast_8      raster NOT NULL,
    rast_16     raster NOT NULL,
    rast_32     raster NOT NULL,
    rast_64     raster NOT NULL,
    PRIMARY KEY (layer_id, tile_row, tile_column)
);
COMMENT ON COLUMN tiles.rast_2 IS 'The same with cells of twice the size: the mean of the known, or one of the codes.';
-- Heights hardly shrink, and packing them costs more time than reading them.
ALTER TABLE tiles ALTER COLUMN rast SET STORAGE EXTERNAL;
ALTER TABLE tiles ALTER COLUMN rast_2 SET STORAGE EXTERNAL;
ALTER TABLE tiles ALTER COLUMN rast_4 SET STORAGE EXTERNAL;
ALTER TABLE tiles ALTER COLUMN rast_8 SET STORAGE EXTERNAL;
CREATE INDEX tiles_by_place ON tiles USING gist (ST_ConvexHull(rast));

CREATE VIEW elevation AS
SELECT r.name AS region, t.tile_row, t.tile_column, t.rast, t.rast_2, t.rast_4, t.rast_8, t.rast_16, t.rast_32, t.rast_64
FROM regions r
JOIN layers l ON l.region_id = r.id AND l.name = 'elevation' AND l.state = 'current'
JOIN tiles t ON t.layer_id = l.id;
COMMENT ON VIEW elevation IS 'The finished elevation of every region, for other programs.';
