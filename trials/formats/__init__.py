"""Writers of datasets in the formats of other tools."""
