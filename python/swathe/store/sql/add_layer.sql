INSERT INTO layers (region_id, name, kind, dtype, digest, inputs, crs, licence, author, time, options, details)
VALUES (%(region)s, %(name)s, %(kind)s, %(dtype)s, %(digest)s, %(inputs)s, %(crs)s, %(licence)s, %(author)s,
        coalesce(nullif(%(time)s, ''), time_now()), %(options)s, %(details)s)
RETURNING id
