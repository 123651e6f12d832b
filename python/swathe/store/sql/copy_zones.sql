COPY zone_polygons (layer_id, ordinal, name, attributes, geom) FROM STDIN (FORMAT binary)
