"""FPGA motion control from register map to moving machine."""
