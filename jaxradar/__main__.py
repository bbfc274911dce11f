"""`python -m jaxradar` is `jaxradar`."""

from jaxradar.cli import main

raise SystemExit(main())
