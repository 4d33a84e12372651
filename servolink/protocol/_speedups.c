/* The two most expensive loops, for `SERVOLINK_COMPILE=1 pip install`. Without them Python does the same: parser.py and
 * row.py are the reference, and tests/protocol/test_compiled.py compares both byte by byte. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <string.h>

#define HEADER_SIZE 8
#define MAGIC_SIZE 4
#define ROOMY (2 * HEADER_SIZE)
#define SLOTS 16
#define MOST_VALUES 16

static const unsigned char MAGIC[MAGIC_SIZE] = {0x13, 0x4c, 0x05, 0x1d};

/* What the header of a frame implies, remembered during one call. */
typedef struct {
    unsigned char header[HEADER_SIZE];
    Py_ssize_t last;     /* where the checksum stands */
    PyObject *packet_id; /* owned; NULL: the slot is empty */
} Slot;

static unsigned char
byte_sum(const unsigned char *bytes, Py_ssize_t size)
{
    unsigned char sum = 0;
    for (Py_ssize_t at = 0; at < size; at++) {
        sum += bytes[at];
    }
    return sum;
}

static int
holds_magic(const unsigned char *bytes, Py_ssize_t size)
{
    const unsigned char *end = bytes + size - MAGIC_SIZE + 1;
    while (bytes < end && (bytes = memchr(bytes, MAGIC[0], (size_t)(end - bytes))) != NULL) {
        if (memcmp(bytes, MAGIC, MAGIC_SIZE) == 0) {
            return 1;
        }
        bytes++;
    }
    return 0;
}

/* Fill `slot` from the entry of `header` in `known`. Return 1, 0 if there is none that can be used here, -1 on error. */
static int
look_up(Slot *slot, const unsigned char *header, PyObject *known)
{
    PyObject *key = PyBytes_FromStringAndSize((const char *)header, HEADER_SIZE);
    if (key == NULL) {
        return -1;
    }
    PyObject *entry = PyDict_GetItemWithError(known, key); /* borrowed */
    Py_DECREF(key);
    if (entry == NULL) {
        return PyErr_Occurred() ? -1 : 0;
    }
    if (!PyTuple_CheckExact(entry) || PyTuple_GET_SIZE(entry) != 4) {
        PyErr_SetString(PyExc_TypeError, "an entry must be a tuple of 4");
        return -1;
    }
    if (PyTuple_GET_ITEM(entry, 3) == Py_False) {
        return 0; /* so long that the parser sums it from blocks */
    }
    Py_ssize_t last = PyLong_AsSsize_t(PyTuple_GET_ITEM(entry, 0));
    if (last == -1 && PyErr_Occurred()) {
        return -1;
    }
    if (last < HEADER_SIZE) {
        PyErr_SetString(PyExc_ValueError, "a frame must not end in its header");
        return -1;
    }
    memcpy(slot->header, header, HEADER_SIZE);
    slot->last = last;
    Py_XSETREF(slot->packet_id, Py_NewRef(PyTuple_GET_ITEM(entry, 1)));
    return 1;
}

static int
append_frame(PyObject *frames, PyObject *packet_id, const unsigned char *content, Py_ssize_t size)
{
    PyObject *bytes = PyBytes_FromStringAndSize((const char *)content, size);
    if (bytes == NULL) {
        return -1;
    }
    PyObject *frame = PyTuple_New(2);
    if (frame == NULL) {
        Py_DECREF(bytes);
        return -1;
    }
    PyTuple_SET_ITEM(frame, 0, Py_NewRef(packet_id));
    PyTuple_SET_ITEM(frame, 1, bytes);
    int failed = PyList_Append(frames, frame);
    Py_DECREF(frame);
    return failed;
}

PyDoc_STRVAR(collect_doc,
"collect(data, at, known, frames, wary)\n--\n\n"
"Append to `frames` the frames that follow each other in `data` from `at` on, and return where they end.\n\n"
"They end before anything that needs a closer look: an incomplete frame, a header that is not in `known`, a wrong\n"
"sum, a content that is summed from blocks, and in the first `wary` frames a content with a frame start inside.");

static PyObject *
collect(PyObject *module, PyObject *const *args, Py_ssize_t count)
{
    if (count != 5 || !PyBytes_Check(args[0]) || !PyDict_Check(args[2]) || !PyList_Check(args[3])) {
        PyErr_SetString(PyExc_TypeError, "collect(bytes, int, dict, list, int)");
        return NULL;
    }
    Py_ssize_t at = PyLong_AsSsize_t(args[1]);
    Py_ssize_t wary = PyLong_AsSsize_t(args[4]);
    if (PyErr_Occurred()) {
        return NULL;
    }
    const unsigned char *data = (const unsigned char *)PyBytes_AS_STRING(args[0]);
    Py_ssize_t length = PyBytes_GET_SIZE(args[0]);
    if (at < 0) {
        PyErr_SetString(PyExc_ValueError, "at must not be negative");
        return NULL;
    }
    Slot slots[SLOTS];
    memset(slots, 0, sizeof(slots));
    int state = 1;
    while (at <= length - HEADER_SIZE) {
        const unsigned char *header = data + at;
        /* Ids are multiples of ten, or one more; lengths mostly differ in their low byte. */
        Slot *slot = &slots[(header[4] ^ header[5] ^ header[6] ^ header[7]) % SLOTS];
        if (slot->packet_id == NULL || memcmp(slot->header, header, HEADER_SIZE) != 0) {
            if ((state = look_up(slot, header, args[2])) != 1) {
                break;
            }
        }
        Py_ssize_t last = slot->last;
        if (last >= length - at || byte_sum(header, last) != header[last]) {
            break;
        }
        const unsigned char *content = header + HEADER_SIZE;
        Py_ssize_t size = last - HEADER_SIZE;
        if (wary > 0) {
            if (last >= ROOMY && holds_magic(content, size)) {
                break;
            }
            wary--;
        }
        if (append_frame(args[3], slot->packet_id, content, size) < 0) {
            state = -1;
            break;
        }
        at += last + 1;
    }
    for (int i = 0; i < SLOTS; i++) {
        Py_XDECREF(slots[i].packet_id);
    }
    return state < 0 ? NULL : PyLong_FromSsize_t(at);
}

/* One value of a row: a `struct` code of standard size. */
typedef struct {
    char code;
    Py_ssize_t size;
} Value;

/* Read a format such as "<ih32s" into `values`. Return the number of values, -1 on error. */
static int
read_format(PyObject *format, int *big, Value *values, Py_ssize_t *row)
{
    const char *text = PyUnicode_AsUTF8(format);
    if (text == NULL) {
        return -1;
    }
    int count = 0;
    *big = text[0] == '>';
    *row = 0;
    for (const char *at = text + (text[0] != '\0'); *at != '\0' && count < MOST_VALUES; at++, count++) {
        Py_ssize_t size = 0;
        for (; *at >= '0' && *at <= '9' && size < 1000; at++) {
            size = 10 * size + (*at - '0');
        }
        if (*at != 's') {
            size = *at == 'B' ? 1 : *at == 'h' || *at == 'H' ? 2 : *at == 'i' || *at == 'I' ? 4 : 0;
        }
        if (size == 0) {
            break;
        }
        values[count] = (Value){*at, size};
        *row += size;
        if (at[1] == '\0') {
            return count + 1;
        }
    }
    PyErr_Format(PyExc_ValueError, "not a format of rows: %R", format);
    return -1;
}

static PyObject *
read_value(const unsigned char *bytes, Value value, int big, const char *encoding)
{
    if (value.code == 's') {
        const unsigned char *end = memchr(bytes, 0, (size_t)value.size);
        return PyUnicode_Decode((const char *)bytes, end == NULL ? value.size : end - bytes, encoding,
                                "servolink.bytes");
    }
    unsigned long number = 0;
    for (Py_ssize_t i = 0; i < value.size; i++) {
        number = number << 8 | bytes[big ? i : value.size - 1 - i];
    }
    switch (value.code) {
    case 'h':
        return PyLong_FromLong((long)(number ^ 0x8000) - 0x8000);
    case 'i':
        return PyLong_FromLongLong((long long)(number ^ 0x80000000) - 0x80000000LL);
    default:
        return PyLong_FromUnsignedLong(number);
    }
}

static PyObject *
read_row(const unsigned char *bytes, const Value *values, int width, int big, PyObject *record, const char *encoding)
{
    PyObject *fields[MOST_VALUES];
    PyObject *made = NULL;
    int read = 0;
    for (; read < width; read++) {
        if ((fields[read] = read_value(bytes, values[read], big, encoding)) == NULL) {
            break;
        }
        bytes += values[read].size;
    }
    if (read == width) {
        made = record == Py_None ? Py_NewRef(fields[0]) : PyObject_Vectorcall(record, fields, (size_t)width, NULL);
    }
    while (read > 0) {
        Py_DECREF(fields[--read]);
    }
    return made;
}

PyDoc_STRVAR(read_rows_doc,
"read_rows(content, start, format, record, encoding)\n--\n\n"
"Return a tuple with a `record` for each row from `start` on, or (None) with the only value of each.\n\n"
"`format` has codes of `struct` for numbers and captions; in `encoding` a single zero byte must end a caption.");

static PyObject *
read_rows(PyObject *module, PyObject *const *args, Py_ssize_t count)
{
    if (count != 5) {
        PyErr_SetString(PyExc_TypeError, "read_rows(bytes, int, str, record or None, str)");
        return NULL;
    }
    Value values[MOST_VALUES];
    Py_ssize_t row = 1;
    int big = 0;
    int width = read_format(args[2], &big, values, &row);
    const char *encoding = width < 0 ? NULL : PyUnicode_AsUTF8(args[4]);
    Py_ssize_t start = encoding == NULL ? -1 : PyLong_AsSsize_t(args[1]);
    Py_buffer content;
    if (PyErr_Occurred() || PyObject_GetBuffer(args[0], &content, PyBUF_SIMPLE) < 0) {
        return NULL;
    }
    PyObject *rows = NULL;
    if (start < 0 || start > content.len || (content.len - start) % row != 0) {
        PyErr_SetString(PyExc_ValueError, "the content must be whole rows");
    } else {
        rows = PyTuple_New((content.len - start) / row);
    }
    for (Py_ssize_t at = 0; rows != NULL && at < PyTuple_GET_SIZE(rows); at++) {
        const unsigned char *bytes = (const unsigned char *)content.buf + start + at * row;
        PyObject *made = read_row(bytes, values, width, big, args[3], encoding);
        if (made == NULL) {
            Py_CLEAR(rows);
        } else {
            PyTuple_SET_ITEM(rows, at, made);
        }
    }
    PyBuffer_Release(&content);
    return rows;
}

static PyMethodDef methods[] = {
    {"collect", (PyCFunction)(void (*)(void))collect, METH_FASTCALL, collect_doc},
    {"read_rows", (PyCFunction)(void (*)(void))read_rows, METH_FASTCALL, read_rows_doc},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = "_speedups",
    .m_doc = "The two most expensive loops.",
    .m_size = 0,
    .m_methods = methods,
};

PyMODINIT_FUNC
PyInit__speedups(void)
{
    return PyModuleDef_Init(&definition);
}
