"""Where drift comes from: attribution by stage, and the Cramér-Rao bound."""
