# Targets: test (default), lint, ci.

# What the tests link against on Debian and Ubuntu: Embree, the libclang that reads its header, a C compiler.
SYSTEM_PACKAGES := libembree-dev libclang-dev gcc libc6-dev
EMBREE := --features embree

.PHONY: test lint ci system-packages

test: system-packages
	cargo test --release $(EMBREE)

lint: system-packages
	cargo fmt --check
	cargo clippy --release --all-targets -- -D warnings
	cargo clippy --release --all-targets $(EMBREE) -- -D warnings

ci:
	.ci/run

# Installs what is missing, as root or through sudo; does nothing elsewhere than on Debian and its kin.
system-packages:
	@command -v apt-get >/dev/null || exit 0; \
	missing=; \
	for package in $(SYSTEM_PACKAGES); do \
	    dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q 'ok installed' || missing="$$missing $$package"; \
	done; \
	[ -z "$$missing" ] && exit 0; \
	echo "installing$$missing with apt-get"; \
	as_root=; [ "$$(id -u)" = 0 ] || as_root=sudo; \
	$$as_root apt-get update -qq && \
	$$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $$missing >/dev/null
