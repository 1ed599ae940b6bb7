"""Localizes photos that come by HTTP."""
