"""Makes a report page, one HTML file, from a finished run of `colmap lazy_localizer`."""
