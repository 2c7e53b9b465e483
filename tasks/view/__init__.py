"""Look at events and rendered clips: pictures, videos, a page that plays them, the Rerun viewer."""
