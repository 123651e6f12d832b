-- Readings are facts: filed once, never changed, withdrawn by another fact.

CREATE TABLE readings (
    region_id           bigint NOT NULL REFERENCES regions ON DELETE CASCADE,
    id                  text NOT NULL,
    revision            bigint NOT NULL,
    author              text NOT NULL,
    time                text NOT NULL,
    instrument          text NOT NULL,
    error               double precision,
    x_m                 double precision NOT NULL,
    y_m                 double precision NOT NULL,
    soil_class          smallint,
    depths_m            double precision[],
    cone_index_kpa      double precision[],
    sleeve_friction_kpa double precision[],
    refusal_depth_m     double precision,
    filed_at            timestamptz NOT NULL DEFAULT clock_timestamp(),
    filed_by            name NOT NULL DEFAULT session_user,
    PRIMARY KEY (region_id, id)
);
COMMENT ON COLUMN readings.soil_class IS 'Somebody''s word on the soil; null for a push of the cone.';
COMMENT ON COLUMN readings.error IS 'Standard deviation of the cone index over the cone index.';
CREATE INDEX readings_by_revision ON readings (region_id, revision, id);

CREATE TABLE withdrawals (
    region_id  bigint NOT NULL,
    reading_id text NOT NULL,
    revision   bigint NOT NULL,
    reason     text NOT NULL,
    PRIMARY KEY (region_id, reading_id),
    FOREIGN KEY (region_id, reading_id) REFERENCES readings ON DELETE CASCADE
);

CREATE FUNCTION refuse_change() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION 'readings are facts: they are never changed, only withdrawn' USING ERRCODE = 'restrict_violation';
END
$$;
CREATE TRIGGER readings_are_facts BEFORE UPDATE ON readings FOR EACH STATEMENT EXECUTE FUNCTION refuse_change();
CREATE TRIGGER withdrawals_are_facts BEFORE UPDATE ON withdrawals FOR EACH STATEMENT EXECUTE FUNCTION refuse_change();

-- One round trip files a batch, all or none. The lock on the region comes first: it keeps writers in one order.
CREATE FUNCTION file_readings(region_name text, batch json) RETURNS integer LANGUAGE plpgsql VOLATILE AS $$
DECLARE
    region regions;
    filed text[];
    authors text[];
BEGIN
    SELECT * INTO region FROM regions WHERE name = region_name FOR UPDATE;
    IF NOT FOUND THEN
        RETURN NULL;
    END IF;
    WITH given AS (
        SELECT * FROM json_to_recordset(batch) AS one (
            id text, author text, time text, instrument text, error double precision, x_m double precision,
            y_m double precision, soil_class smallint, depths_m double precision[], cone_index_kpa double precision[],
            sleeve_friction_kpa double precision[], refusal_depth_m double precision
        )
    ), added AS (
        INSERT INTO readings
        SELECT region.id, id, region.revision + 1, author, time, instrument, error, x_m, y_m, soil_class, depths_m,
               cone_index_kpa, sleeve_friction_kpa, refusal_depth_m
        FROM given
        ON CONFLICT DO NOTHING
        RETURNING id, author
    )
    SELECT array_agg(added.id ORDER BY added.id COLLATE "C"), array_agg(DISTINCT added.author ORDER BY added.author)
    INTO filed, authors FROM added;
    IF filed IS NULL THEN
        RETURN 0;
    END IF;
    PERFORM note_change(region.id, 'readings', '', cardinality(filed),
                        CASE WHEN cardinality(authors) = 1 THEN authors[1] ELSE '' END, json_build_object('ids', filed));
    RETURN cardinality(filed);
END
$$;

CREATE FUNCTION withdraw_readings(region_name text, of_instrument text, of_author text, of_ids text[], why text)
RETURNS integer LANGUAGE plpgsql VOLATILE AS $$
DECLARE
    region regions;
    gone text[];
BEGIN
    SELECT * INTO region FROM regions WHERE name = region_name FOR UPDATE;
    IF NOT FOUND THEN
        RETURN NULL;
    END IF;
    WITH added AS (
        INSERT INTO withdrawals
        SELECT region_id, id, region.revision + 1, why FROM readings
        WHERE region_id = region.id
          AND (instrument = of_instrument OR author = of_author OR id = ANY (of_ids))
        ON CONFLICT DO NOTHING
        RETURNING reading_id
    )
    SELECT array_agg(reading_id ORDER BY reading_id COLLATE "C") INTO gone FROM added;
    IF gone IS NULL THEN
        RETURN 0;
    END IF;
    PERFORM note_change(region.id, 'withdrawal', '', cardinality(gone), '',
                        json_build_object('ids', gone, 'reason', why));
    RETURN cardinality(gone);
END
$$;
