"""JSBSim's F450 on a thrust stand and in flight: a multirotor of an independent simulator, identified from its outputs."""
