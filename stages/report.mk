# report: all of the above → report.json, report.html and figures
$(REPORT): $(RUN)/settings/report.yaml $(SCENE) $(SNAPSHOTS) $(TESTS) $(BASIS) $(MODEL) $(CUBATURE) $(SIMULATION) | $(ENVIRONMENT)
	$(call stage,report)

report: $(REPORT) ## stage 7 and the default: write the report
	$(call done,$<)
