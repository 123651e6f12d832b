INSERT INTO runs (region_id, id, log, summary, author, time)
VALUES (%(region)s, %(id)s, %(log)s, %(summary)s, %(author)s, coalesce(nullif(%(time)s, ''), time_now()))
ON CONFLICT (region_id, id) DO UPDATE
SET log = excluded.log, summary = excluded.summary, author = excluded.author, time = excluded.time
