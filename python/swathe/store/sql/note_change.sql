SELECT note_change(%(region)s, %(kind)s, %(subject)s, %(count)s, %(author)s, %(detail)s)
