SELECT count(*) FROM spatial_ref_sys WHERE srid = %s
