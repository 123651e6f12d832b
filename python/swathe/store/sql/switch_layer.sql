SELECT switch_layer(%s)
