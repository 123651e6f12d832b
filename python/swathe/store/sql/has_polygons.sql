SELECT id FROM layers WHERE region_id = %s AND name = %s AND kind = 'polygons' AND state = 'current'
