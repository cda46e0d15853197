# snapshot: scene and motions → full-space runs; interrupted, it goes on at the frame it had reached. Motions of the role
# test have a file and a stamp of their own, for nothing before simulate may read them or be stale because of one. The
# command makes both files and leaves alone the one that holds what it is to hold; touch tells make that it was looked at.
$(SNAPSHOTS): $(RUN)/settings/snapshot.yaml $(SCENE) | $(ENVIRONMENT)
	$(call stage,snapshot)$(eval BOTH := yes)
	@touch $@

$(TESTS): $(RUN)/settings/tests.yaml $(SCENE) | $(SNAPSHOTS) $(ENVIRONMENT)
	$(if $(BOTH),,$(call stage,snapshot))
	@touch $@

snapshot: $(SNAPSHOTS) $(TESTS) ## stage 2: run the motions in the full space
	$(call done,$<)
