/* The paths that a unit of FMI 2 finds in URIs, one a line, for the sanitizers to watch. */
#define FMI 2
#include "fmu.c"

int main(int count, char **uris)
{
    for (int i = 1; i < count; i++) {
        char *path = malloc(strlen(uris[i]) + 1); /* no byte more, so that one too far is seen */
        if (!path) return 1;
        strcpy(path, uris[i]);
        puts(path_in(path));
        free(path);
    }
    return 0;
}
