SELECT a.id, a.author, a.time, a.instrument, a.error, a.revision, w.revision, coalesce(w.reason, ''), a.x_m, a.y_m,
       a.soil_class, a.depths_m, a.cone_index_kpa, a.refusal_depth_m, a.sleeve_friction_kpa
FROM readings a
LEFT JOIN withdrawals w ON w.region_id = a.region_id AND w.reading_id = a.id
    AND (%(until)s::bigint IS NULL OR w.revision <= %(until)s)
WHERE a.region_id = %(region)s AND a.revision > %(since)s AND (%(until)s::bigint IS NULL OR a.revision <= %(until)s)
  AND (%(withdrawn)s OR w.revision IS NULL)
ORDER BY a.revision, a.id COLLATE "C"
