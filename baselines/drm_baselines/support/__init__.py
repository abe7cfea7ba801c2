"""What every room uses: files, memory, processes, signals, pictures, seeds."""
