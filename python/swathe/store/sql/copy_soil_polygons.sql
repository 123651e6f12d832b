COPY soil_polygons (layer_id, ordinal, value, soil_class, cat, attributes, geom) FROM STDIN (FORMAT binary)
