"""Pictures and pages for people: the map, the profile along the route, and one self-contained HTML report."""
