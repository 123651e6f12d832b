-- The schema of ours first, then those that hold the extensions; and limits where the user has set none.
SELECT set_config('search_path', (
           SELECT string_agg(quote_ident(place), ', ' ORDER BY rank, place)
           FROM (
               SELECT 'swathe' AS place, 1 AS rank
               UNION
               SELECT n.nspname, 2
               FROM pg_extension e JOIN pg_namespace n ON n.oid = e.extnamespace
               WHERE e.extname IN ('postgis', 'postgis_raster') AND n.nspname <> 'public'
               UNION
               SELECT 'public', 3
           ) places
       ), false),
       CASE WHEN current_setting('statement_timeout') = '0' THEN set_config('statement_timeout', %s, false) END,
       CASE WHEN current_setting('lock_timeout') = '0' THEN set_config('lock_timeout', '15s', false) END,
       set_config('datestyle', 'ISO', false),
       set_config('extra_float_digits', '3', false)
