DELETE FROM layers
WHERE region_id = %(region)s AND name = %(name)s
  AND (state = 'replaced'
       OR (state = 'staged' AND (kind, dtype, digest) IS DISTINCT FROM (%(kind)s, %(dtype)s, %(digest)s)))
