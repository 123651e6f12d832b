DELETE FROM layers WHERE id = %s AND state = 'staged'
