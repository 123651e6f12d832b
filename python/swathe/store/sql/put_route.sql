INSERT INTO routes (region_id, id, vehicle, summary, author, time, geom)
VALUES (%(region)s, %(id)s, %(vehicle)s, %(summary)s, %(author)s, coalesce(nullif(%(time)s, ''), time_now()),
        ST_GeomFromWKB(%(wkb)s, %(srid)s))
ON CONFLICT (region_id, id) DO UPDATE
SET vehicle = excluded.vehicle, summary = excluded.summary, author = excluded.author, time = excluded.time,
    geom = excluded.geom
