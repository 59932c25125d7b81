"""The one door for reading HDF5: files that nobody has to trust."""
