SELECT withdraw_readings(%s, %s, %s, %s, %s)
