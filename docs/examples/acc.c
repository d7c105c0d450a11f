/* The adaptive cruise control of ten_line_acc.py in C: one JSON text a line in, one out.
 *   cc -O2 -o acc acc.c      and then      controller = "exec:./acc" */
#include <stdio.h>
#include <string.h>

static double number(const char *from, const char *key) {
    double value = 0.0;
    const char *found = strstr(from, key);
    if (found) sscanf(found + strlen(key), "%lf", &value);
    return value;
}

int main(void) {
    static char line[1 << 16];
    while (fgets(line, sizeof line, stdin)) {
        if (strstr(line, "\"type\":\"reset\"")) {
            puts("{}");
        } else {
            const char *lead = strstr(line, "\"lead\":{");
            double speed = number(strstr(line, "\"ego\":{"), "\"speed\":"), acceleration = 0.0;
            if (lead) {
                double gap = number(lead, "\"gap\":"), closing = number(lead, "\"relative_speed\":");
                double wanted = 3.0 + 1.5 * speed;
                acceleration = 0.15 * (gap - wanted) + 0.9 * closing;
                if (gap > wanted && acceleration > 0.0) acceleration = 0.0;
                if (acceleration > 2.0) acceleration = 2.0;
                if (acceleration < -6.0) acceleration = -6.0;
            }
            printf("{\"acceleration\": %.17g}\n", acceleration);
        }
        fflush(stdout); /* or the harness waits for ever, and then ends the program */
    }
    return 0;
}
