# cubature: scene, snapshots, basis and model → points and weights
$(CUBATURE): $(RUN)/settings/cubature.yaml $(SCENE) $(SNAPSHOTS) $(BASIS) $(MODEL) | $(ENVIRONMENT)
	$(call stage,cubature)

cubature: $(CUBATURE) ## stage 5: choose the cubature points
	$(call done,$<)
