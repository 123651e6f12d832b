SELECT pg_advisory_unlock(hashtextextended('swathe schema', 0))
