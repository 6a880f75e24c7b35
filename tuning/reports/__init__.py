"""What is said of a study: tables, figures and pages."""
