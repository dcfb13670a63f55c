"""The Makefile."""

from __future__ import annotations

from .form import Form

#: Flags that the text is written for.
FLAGS = (
    *("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"),
    *("-ffp-contract=off", "-fno-math-errno"),
)

_TEXT = """# make test | make sanitize; CFLAGS="-O3 -march=native" takes fma where there is one.
CC ?= cc
CFLAGS ?= -O2
FLAGS = @FLAGS@

@.o: @.c @.h
	$(CC) $(FLAGS) $(CFLAGS) -c @.c -o @.o

test: @.o test_@.c
	$(CC) $(FLAGS) $(CFLAGS) test_@.c @.o -o test_@@LIBM@
	./test_@

sanitize: @.c @.h test_@.c
	$(CC) $(FLAGS) -O0 -g -fsanitize=address,undefined -fno-sanitize-recover=all \\
		test_@.c @.c -o sanitized_@@LIBM@
	./sanitized_@

clean:
	rm -f @.o test_@ sanitized_@

.PHONY: test sanitize clean
"""


def makefile(form: Form) -> str:
    """Its text."""
    text = _TEXT.replace("@FLAGS@", " ".join(FLAGS))
    return text.replace("@LIBM@", " -lm" if form.libm else "").replace("@", form.name)
