"""Other libraries behind the interface of this room.

One step is one run of the library to its own end; the next starts from fresh random numbers. What a run asks is
booked as for any other optimizer, and budget, target or Ctrl-C end it in the middle.
"""
