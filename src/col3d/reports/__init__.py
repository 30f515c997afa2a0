"""Reports: read the tables that runs wrote, and make tables and figures of them; without torch."""
