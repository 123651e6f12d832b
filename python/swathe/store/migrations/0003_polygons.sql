-- Soil maps and zones as polygons in the frame of their region.

CREATE TABLE soil_polygons (
    layer_id   bigint NOT NULL REFERENCES layers ON DELETE CASCADE,
    ordinal    bigint NOT NULL,
    value      text NOT NULL,
    soil_class smallint NOT NULL,
    cat        bigint,
    attributes json NOT NULL,
    geom       geometry NOT NULL,
    PRIMARY KEY (layer_id, ordinal)
);
COMMENT ON COLUMN soil_polygons.soil_class IS '0 unknown, 1 gravel, 2 sand, 3 clay, 4 silt, 5 rock, 6 none (water, peat).';
CREATE INDEX soil_polygons_by_place ON soil_polygons USING gist (geom);

CREATE TABLE zone_polygons (
    layer_id   bigint NOT NULL REFERENCES layers ON DELETE CASCADE,
    ordinal    bigint NOT NULL,
    name       text NOT NULL,
    attributes json NOT NULL,
    geom       geometry NOT NULL,
    PRIMARY KEY (layer_id, ordinal)
);
CREATE INDEX zone_polygons_by_place ON zone_polygons USING gist (geom);

CREATE VIEW soil AS
SELECT r.name AS region, s.ordinal, s.value, s.soil_class, s.cat, s.attributes, s.geom
FROM regions r
JOIN layers l ON l.region_id = r.id AND l.name = 'soil' AND l.state = 'current'
JOIN soil_polygons s ON s.layer_id = l.id;

CREATE VIEW zones AS
SELECT r.name AS region, z.ordinal, z.name, z.attributes, z.geom
FROM regions r
JOIN layers l ON l.region_id = r.id AND l.name = 'zones' AND l.state = 'current'
JOIN zone_polygons z ON z.layer_id = l.id;
