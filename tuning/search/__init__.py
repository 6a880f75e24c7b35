"""Search of tuning: descents with line search, and ascents for worst cases."""
