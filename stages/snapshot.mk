# snapshot: scene and motions → full-space runs; interrupted, it goes on at the frame it had reached
$(SNAPSHOTS): $(RUN)/settings/snapshot.yaml $(SCENE) | $(ENVIRONMENT)
	$(call stage,snapshot)

snapshot: $(SNAPSHOTS) ## stage 2: run the motions in the full space
	$(call done,$<)
