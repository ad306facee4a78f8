"""The attribute of Datasets and stores that identifies their sweep."""

ATTRIBUTE = "clothsim_sweep"
"""JSON text. Not "clothsim": that is the accessor, which xarray would hide behind it."""

OLD_ATTRIBUTE = "clothsim"
"""Its name in stores of earlier versions, which are still read and resumed."""
