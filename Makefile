.PHONY: demo test test-full lint bench docs
demo: ; scripts/demo
test: ; scripts/test
test-full: ; scripts/test --full
lint: ; scripts/lint
bench: ; cargo bench --workspace --benches
docs: ; cargo doc --release --workspace --no-deps
