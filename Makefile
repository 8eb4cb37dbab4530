.PHONY: demo test test-full lint bench docs package
demo: ; scripts/demo
test: ; scripts/test
test-full: ; scripts/test --full
lint: ; scripts/lint
bench: ; scripts/bench
docs: ; scripts/docs
package: ; scripts/package
