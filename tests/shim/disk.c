/* A disk and a clock under a test's control, preloaded into a coordinator (LD_PRELOAD).
 *
 * MANDUCA_SHIM_FOLDER   files below this folder are watched
 * MANDUCA_SHIM_JOURNAL  where every write, truncation and sync of theirs is noted, in order:
 *                       what a power cut would leave can be told from it
 * MANDUCA_SHIM_CONTROL  a file read before each call: `full` refuses writes (ENOSPC), `sync`
 *                       refuses syncs (EIO), `clock N` moves the wall clock by N seconds
 *
 * A record of the journal: kind (w, t, s, u), length of the path, offset, length of the data
 * (three 64-bit numbers), the path, the data.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int journal = -1;

static const char *watched(int fd, char *path, size_t size) {
    const char *folder = getenv("MANDUCA_SHIM_FOLDER");
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, size - 1);
    if (!folder || n <= 0) return NULL;
    path[n] = 0;
    if (strncmp(path, folder, strlen(folder)) != 0 || strstr(path, "-shm")) return NULL;
    return path;
}

static long control(const char *word) {
    const char *file = getenv("MANDUCA_SHIM_CONTROL");
    char text[128] = {0};
    int fd = file ? (int)syscall(SYS_openat, AT_FDCWD, file, O_RDONLY) : -1;
    if (fd < 0) return 0;
    ssize_t n = syscall(SYS_read, fd, text, sizeof text - 1);
    syscall(SYS_close, fd);
    if (n <= 0) return 0;
    char *found = strstr(text, word);
    if (!found) return 0;
    long value = strtol(found + strlen(word), NULL, 10);
    return value ? value : 1;
}

static void note(char kind, const char *path, int64_t offset, const void *data, size_t length) {
    const char *file = getenv("MANDUCA_SHIM_JOURNAL");
    if (!file) return;
    size_t named = strlen(path), size = 1 + 24 + named + length;
    char *record = malloc(size);
    if (!record) abort();
    int64_t numbers[3] = {(int64_t)named, offset, (int64_t)length};
    record[0] = kind;
    memcpy(record + 1, numbers, 24);
    memcpy(record + 25, path, named);
    if (length) memcpy(record + 25 + named, data, length);
    pthread_mutex_lock(&lock);
    if (journal < 0) journal = (int)syscall(SYS_openat, AT_FDCWD, file, O_WRONLY | O_CREAT | O_APPEND, 0600);
    /* One call: a kill leaves a whole record or none. */
    if (syscall(SYS_write, journal, record, size) != (long)size) abort();
    pthread_mutex_unlock(&lock);
    free(record);
}

static ssize_t put(int fd, const void *data, size_t length, off64_t offset) {
    char path[4096];
    if (watched(fd, path, sizeof path)) {
        if (control("full")) { errno = ENOSPC; return -1; }
        note('w', path, offset, data, length);
    }
    return syscall(SYS_pwrite64, fd, data, length, offset);
}

ssize_t pwrite(int fd, const void *data, size_t length, off_t offset) { return put(fd, data, length, offset); }
ssize_t pwrite64(int fd, const void *data, size_t length, off64_t offset) { return put(fd, data, length, offset); }

static int cut(int fd, off64_t length) {
    char path[4096];
    if (watched(fd, path, sizeof path)) note('t', path, length, NULL, 0);
    return (int)syscall(SYS_ftruncate, fd, length);
}

int ftruncate(int fd, off_t length) { return cut(fd, length); }
int ftruncate64(int fd, off64_t length) { return cut(fd, length); }

static int settle(int fd, long number) {
    char path[4096];
    const char *known = watched(fd, path, sizeof path);
    if (known && control("sync")) { errno = EIO; return -1; }
    int done = (int)syscall(number, fd);
    struct stat status;
    if (known && done == 0 && fstat(fd, &status) == 0 && S_ISREG(status.st_mode)) note('s', path, 0, NULL, 0);
    return done;
}

int fsync(int fd) { return settle(fd, SYS_fsync); }
int fdatasync(int fd) { return settle(fd, SYS_fdatasync); }

int unlink(const char *path) {
    const char *folder = getenv("MANDUCA_SHIM_FOLDER");
    if (folder && strncmp(path, folder, strlen(folder)) == 0 && !strstr(path, "-shm")) note('u', path, 0, NULL, 0);
    return (int)syscall(SYS_unlinkat, AT_FDCWD, path, 0);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    int done = (int)syscall(SYS_clock_gettime, clock, now);
    if (done == 0 && clock == CLOCK_REALTIME) now->tv_sec += control("clock");
    return done;
}
