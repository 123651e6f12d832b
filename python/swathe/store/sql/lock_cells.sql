SELECT pg_advisory_xact_lock(hashtextextended('swathe cells ' || %s::text, 0))
