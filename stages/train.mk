# train: scene, snapshots and basis → the autoencoder
$(MODEL): $(RUN)/settings/train.yaml $(SCENE) $(SNAPSHOTS) $(BASIS) | $(ENVIRONMENT)
	$(call stage,train)

train: $(MODEL) ## stage 4: train the autoencoder
	$(call done,$<)
