SELECT has_table_privilege('cells', 'INSERT') AND current_setting('transaction_read_only') = 'off'
