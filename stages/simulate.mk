# simulate: all of the above → the motions in the full, linear and latent space
$(SIMULATION): $(RUN)/settings/simulate.yaml $(SCENE) $(SNAPSHOTS) $(TESTS) $(BASIS) $(MODEL) $(CUBATURE) | $(ENVIRONMENT)
	$(call stage,simulate)

simulate: $(SIMULATION) ## stage 6: run the motions in the reduced spaces and compare
	$(call done,$<)
