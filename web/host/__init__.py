"""What builds the site: tables and constants from Python, the bundle by Node.js, and OpenCV."""
