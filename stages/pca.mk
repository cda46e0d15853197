# pca: scene and snapshots → the linear basis
$(BASIS): $(RUN)/settings/pca.yaml $(SCENE) $(SNAPSHOTS) | $(ENVIRONMENT)
	$(call stage,pca)

pca: $(BASIS) ## stage 3: find the linear basis
	$(call done,$<)
