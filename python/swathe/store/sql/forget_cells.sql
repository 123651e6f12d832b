DELETE FROM cells WHERE region_id = %(region)s
