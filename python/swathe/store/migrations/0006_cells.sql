-- The paper's table: a row for every cell of a region, averaged by groups of 8 x 8 pixels.

CREATE TABLE cell_tables (
    region_id          bigint PRIMARY KEY REFERENCES regions ON DELETE CASCADE,
    elevation_layer_id bigint NOT NULL,
    soil_layer_id      bigint,
    soil_report        json
);
COMMENT ON TABLE cell_tables IS 'Which layers the cells of a region were made from.';

CREATE TABLE cells (
    region_id         bigint NOT NULL REFERENCES regions ON DELETE CASCADE,
    "row"             integer NOT NULL,
    "column"          integer NOT NULL,
    height            real,
    elevation_m       real,
    steepest_grade    real,
    soil_category     smallint NOT NULL,
    gradient_goodness smallint,
    soil_goodness     smallint,
    rank              smallint,
    PRIMARY KEY (region_id, "row", "column")
);
COMMENT ON TABLE cells IS 'Rows and columns count groups of 8 x 8 pixels from the north-west.';
COMMENT ON COLUMN cells.height IS 'Mean grey level of the group, 0 (lowest of the region) to 255 (highest); null unknown.';
COMMENT ON COLUMN cells.elevation_m IS 'Mean height of the group in metres.';
COMMENT ON COLUMN cells.steepest_grade IS 'Greatest slope inside the group, rise over run.';
COMMENT ON COLUMN cells.gradient_goodness IS 'Table I of the paper, 5 (level) to 1, of the worst of eight differences.';
COMMENT ON COLUMN cells.soil_goodness IS 'Order of the paper''s text, 5 (gravel) to 1 (rock), 3 where unknown.';
COMMENT ON COLUMN cells.rank IS 'Equation 1: the sum of both, 2 (worst) to 10; 0 where the height is unknown.';
