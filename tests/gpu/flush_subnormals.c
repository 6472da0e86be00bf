// Makes lavapipe a device that flushes subnormal numbers: the threads that this driver starts get the two bits of the
// control register that say so, all others keep theirs. `tests/gpu/with_device` compiles and preloads it.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <xmmintrin.h>

// Results that are subnormal are zero, and operands that are count as zero.
enum { FLUSH_TO_ZERO = 1 << 15, DENORMALS_ARE_ZERO = 1 << 6 };

typedef void *Work(void *);
typedef int Create(pthread_t *, const pthread_attr_t *, Work *, void *);

struct start {
    Work *work;
    void *argument;
};

static void *flushing(void *given) {
    struct start start = *(struct start *)given;
    free(given);
    _mm_setcsr(_mm_getcsr() | FLUSH_TO_ZERO | DENORMALS_ARE_ZERO);
    return start.work(start.argument);
}

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, Work *work, void *argument) {
    Create *create = (Create *)dlsym(RTLD_NEXT, "pthread_create");
    Dl_info from;
    if (dladdr((void *)work, &from) == 0 || strstr(from.dli_fname, "libvulkan_lvp") == NULL) {
        return create(thread, attributes, work, argument);
    }
    struct start *start = malloc(sizeof *start);
    if (start == NULL) {
        abort();
    }
    *start = (struct start){work, argument};
    return create(thread, attributes, flushing, start);
}
