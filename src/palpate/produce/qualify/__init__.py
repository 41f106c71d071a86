"""How well grasps agree with a reference instrument, and how well any instrument could."""
