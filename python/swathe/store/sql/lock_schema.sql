SELECT pg_advisory_lock(hashtextextended('swathe schema', 0))
