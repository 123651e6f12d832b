SELECT id FROM layers
WHERE region_id = %(region)s AND name = %(name)s AND kind = %(kind)s AND dtype = %(dtype)s AND digest = %(digest)s
  AND state = 'current'
