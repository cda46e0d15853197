# cubature: scene, snapshots, basis and model → points and weights. Status 3 means that the sets are written and whole, but
# one of them misses its tolerance: no reason to stop, the report says so too.
$(CUBATURE): $(RUN)/settings/cubature.yaml $(SCENE) $(SNAPSHOTS) $(BASIS) $(MODEL) | $(ENVIRONMENT)
	$(call stage,cubature) || { status=$$?; [ $$status -eq 3 ] || exit $$status; \
	    echo "make: a cubature set misses its tolerance (warning above); going on with it" >&2; }

cubature: $(CUBATURE) ## stage 5: choose the cubature points
	$(call done,$<)
