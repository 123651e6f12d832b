SELECT pg_advisory_lock(hashtextextended('swathe layer ' || %s::text || ' ' || %s::text, 0))
