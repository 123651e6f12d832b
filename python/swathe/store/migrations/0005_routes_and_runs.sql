-- What was planned and driven.

CREATE TABLE routes (
    region_id bigint NOT NULL REFERENCES regions ON DELETE CASCADE,
    id        text NOT NULL,
    vehicle   text NOT NULL,
    summary   json NOT NULL,
    author    text NOT NULL,
    time      text NOT NULL,
    geom      geometry NOT NULL,
    PRIMARY KEY (region_id, id)
);
CREATE INDEX routes_by_place ON routes USING gist (geom);

CREATE TABLE runs (
    region_id bigint NOT NULL REFERENCES regions ON DELETE CASCADE,
    id        text NOT NULL,
    log       text NOT NULL,
    summary   json NOT NULL,
    author    text NOT NULL,
    time      text NOT NULL,
    PRIMARY KEY (region_id, id)
);
COMMENT ON COLUMN runs.log IS 'Path of the log, which stays where it is.';
