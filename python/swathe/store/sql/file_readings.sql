SELECT file_readings(%s, %s)
