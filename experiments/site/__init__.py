"""The documentation site: pages that are made of code, notebooks and documents when it is built."""
