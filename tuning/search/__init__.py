"""How tuning minimises: descents with line search, and ascents for worst cases."""
