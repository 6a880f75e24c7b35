"""Reports on studies: tables, figures and pages."""
