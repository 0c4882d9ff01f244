"""The local app: a face of the command line in a browser, for one user on this machine.

Every step is an ordinary stoop command, shown, kept in the folder and run as a process of its own that writes ordinary files.
What the page shows is read from that folder, so that a browser that closes, or a server that is killed, loses nothing.
"""
