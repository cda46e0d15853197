# mesh: a mesh file or a shape → the scene
$(SCENE): $(RUN)/settings/mesh.yaml | $(ENVIRONMENT)
	$(call stage,mesh)

mesh: $(SCENE) ## stage 1: read or make the mesh and write the scene
	$(call done,$<)
