SELECT max(id) FILTER (WHERE name = 'elevation'), max(id) FILTER (WHERE name = 'soil')
FROM layers
WHERE region_id = %s AND state = 'current'
