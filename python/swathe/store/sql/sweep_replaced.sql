DELETE FROM layers WHERE region_id = %(region)s AND name = %(name)s AND state = 'replaced'
