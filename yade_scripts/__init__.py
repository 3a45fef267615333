"""The scenes that run inside YADE; nothing here is imported by `analysis` or `campaign`."""
