-- Regions, the layers of each, and what changed when.

CREATE TABLE regions (
    id            bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    name          text NOT NULL UNIQUE,
    crs_wkt       text,
    srid          integer NOT NULL DEFAULT 0,
    rows          integer NOT NULL CHECK (rows > 0),
    columns       integer NOT NULL CHECK (columns > 0),
    cell_size_m   double precision NOT NULL CHECK (cell_size_m > 0),
    west_m        double precision NOT NULL,
    north_m       double precision NOT NULL,
    file_origin_x double precision NOT NULL DEFAULT 0,
    file_origin_y double precision NOT NULL DEFAULT 0,
    file_unit_m   double precision NOT NULL DEFAULT 1,
    revision      bigint NOT NULL DEFAULT 0
);
COMMENT ON TABLE regions IS 'The lattice that all rasters of a region share. Row 0 is the north edge.';
COMMENT ON COLUMN regions.srid IS 'EPSG number of crs_wkt, 0 where it has none.';
COMMENT ON COLUMN regions.revision IS 'Number of the latest change.';

CREATE TABLE layers (
    id        bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    region_id bigint NOT NULL REFERENCES regions ON DELETE CASCADE,
    name      text NOT NULL,
    kind      text NOT NULL CHECK (kind IN ('raster', 'polygons')),
    dtype     text NOT NULL DEFAULT '',
    state     text NOT NULL DEFAULT 'staged' CHECK (state IN ('staged', 'current', 'replaced')),
    digest    text NOT NULL,
    inputs    json NOT NULL,
    crs       text NOT NULL,
    licence   text NOT NULL,
    author    text NOT NULL,
    time      text NOT NULL,
    options   json NOT NULL,
    details   json NOT NULL
);
CREATE UNIQUE INDEX layers_one_is_current ON layers (region_id, name) WHERE state = 'current';
CREATE INDEX layers_of_region ON layers (region_id, name, state);
COMMENT ON COLUMN layers.state IS 'Readers see what is current; staged is being imported, replaced is to be removed.';

CREATE TABLE changes (
    region_id bigint NOT NULL REFERENCES regions ON DELETE CASCADE,
    revision  bigint NOT NULL,
    time      text NOT NULL,
    kind      text NOT NULL CHECK (kind IN ('region', 'layer', 'readings', 'withdrawal', 'route', 'run')),
    subject   text NOT NULL,
    count     integer NOT NULL,
    author    text NOT NULL,
    detail    json NOT NULL,
    PRIMARY KEY (region_id, revision)
);

CREATE FUNCTION time_now() RETURNS text LANGUAGE sql VOLATILE AS $$
    SELECT to_char(clock_timestamp() AT TIME ZONE 'UTC', 'YYYY-MM-DD"T"HH24:MI:SS.US"Z"')
$$;

-- The lock on the region's row makes revisions count up without a gap in the order in which they become visible.
CREATE FUNCTION note_change(changed bigint, kind text, subject text, count integer, author text, detail json)
RETURNS bigint LANGUAGE sql VOLATILE AS $$
    WITH next AS (
        UPDATE regions SET revision = revision + 1 WHERE id = changed RETURNING id, revision
    ), told AS (
        INSERT INTO changes
        SELECT id, revision, time_now(), $2, $3, $4, $5, $6 FROM next
        RETURNING region_id, revision
    )
    SELECT revision FROM told, LATERAL pg_notify('swathe_changes', region_id::text)
$$;

-- In one step readers see the new layer for the old.
CREATE FUNCTION switch_layer(new bigint) RETURNS bigint LANGUAGE plpgsql VOLATILE AS $$
DECLARE
    layer layers;
    added bigint;
BEGIN
    SELECT * INTO STRICT layer FROM layers WHERE id = new AND state = 'staged' FOR UPDATE;
    added := note_change(layer.region_id, 'layer', layer.name, 1, layer.author,
                         json_build_object('digest', layer.digest));
    UPDATE layers SET state = 'replaced'
    WHERE region_id = layer.region_id AND name = layer.name AND state = 'current';
    UPDATE layers SET state = 'current' WHERE id = new;
    RETURN added;
END
$$;
