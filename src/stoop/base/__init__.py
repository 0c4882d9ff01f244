"""What every room uses: units, rotations, files, arrays, tables and notices."""
