SELECT revision, time, kind, subject, count, author, detail FROM changes
WHERE region_id = %s AND revision > %s
ORDER BY revision
